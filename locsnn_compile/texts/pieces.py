"""Texts of many parts as pieces of markup, in files next to the code that fills them."""

from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any

from locsnn_compile.texts.templates import Filler, sections


class Pieces(Filler):
    """The pieces of a file by name: markup with places for what some content holds, ``self`` the content as a whole.

    ``{facts:each fact}`` stands for a piece of that name for each fact, ``{blocks:each}`` for one by the type of
    each block, ``{facts:some facts}`` for one if there are any. Values with no format are escaped; ``shown`` are
    further formats. Line breaks are left out if ``folded``. ``given`` fills places ``@@name@@`` of the file.
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
        super().__init__(
            {"": lambda value: escape(str(value)), "raw": str, "each": self.each, "some": self.some, **shown}
        )
        found = sections(package, file, **(given or {}))
        self._pieces = {name: "".join(piece.splitlines()) if folded else piece for name, piece in found.items()}

    def each(self, values: Iterable[Any], name: str = "") -> str:
        """Return a piece for each value, by default that of its type; each knows its ``index``."""
        return "".join(self.piece(name or type(value).__name__, value, i) for i, value in enumerate(values))

    def some(self, values: Collection[Any], name: str) -> str:
        """Return a piece of all values, nothing where there are none."""
        return self.piece(name, values) if values else ""

    def piece(self, name: str, content: Any, index: int = 0, **more: Any) -> str:
        """Return a piece, filled with what some content holds, a mapping or any object, and more."""
        held = content if isinstance(content, Mapping) else getattr(content, "__dict__", {})
        return self.fill(self._pieces[name], {"self": content, "index": index, **held, **more})
