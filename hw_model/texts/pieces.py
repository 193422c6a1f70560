"""Texts assembled from pieces of markup, which lie in files next to the code that fills them."""

from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any

from hw_model.texts.templates import Filler, sections


class Pieces(Filler):
    """The pieces of a file by name: markup with placeholders for the fields of some content, or ``self`` for all.

    ``{facts:each fact}`` stands for the piece ``fact`` for each fact, ``{blocks:each}`` for the piece of the type of
    each block, ``{facts:some facts}`` for one piece if there are any, and ``{fact:piece fact}`` for one if it is not
    None. Values without a format are escaped; ``shown`` are further formats. ``folded`` removes line breaks. ``given``
    fills placeholders ``@@name@@``.
    """

    def __init__(
        self,
        package: str,
        file: str,
        escape: Callable[[str], str],
        *,
        folded: bool = False,
        given: Mapping[str, str] | None = None,
        **shown: Callable[..., str],
    ) -> None:
        inside = {
            "each": self.each,
            "some": self.some,
            "piece": lambda value, name: self.piece(name, value),
        }
        super().__init__({"": lambda value: escape(str(value)), "raw": str, **inside, **shown})
        found = sections(package, file, **(given or {}))
        self._pieces = {
            name: "".join(piece.splitlines()) if folded else piece for name, piece in found.items()
        }

    def each(self, values: Iterable[Any], name: str = "") -> str:
        """Return a piece for each value, by default that of its type, with its ``index``."""
        return "".join(
            self.piece(name or type(value).__name__, value, i) for i, value in enumerate(values)
        )

    def some(self, values: Collection[Any], name: str) -> str:
        """Return a piece for all values together; nothing if there are none."""
        return self.piece(name, values) if values else ""

    def piece(self, name: str, content: Any, index: int = 0, **more: Any) -> str:
        """Return a piece, filled with the fields of some content, a mapping or an object, and with more values."""
        held = content if isinstance(content, Mapping) else getattr(content, "__dict__", {})
        return self.fill(self._pieces[name], {"self": content, "index": index, **held, **more})
