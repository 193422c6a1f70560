"""Value change dumps, read back by the reader of pyvcd."""

from __future__ import annotations

import io

from vcd.reader import TokenKind, tokenize


def read_vcd(content):
    """Return ``{path: [(time, text of the value)]}`` and the last time."""
    paths, scopes, codes, time = {}, [], {}, 0
    for token in tokenize(io.BytesIO(content)):
        if token.kind is TokenKind.SCOPE:
            scopes.append(token.scope.ident)
        elif token.kind is TokenKind.UPSCOPE:
            scopes.pop()
        elif token.kind is TokenKind.VAR:
            path = ".".join([*scopes, token.var.reference])
            assert path not in paths
            codes[token.var.id_code] = (path, token.var.size)
            paths[path] = []
        elif token.kind is TokenKind.CHANGE_TIME:
            time = token.time_change
        elif token.kind in (TokenKind.CHANGE_SCALAR, TokenKind.CHANGE_VECTOR):
            change = token.data
            path, size = codes[change.id_code]
            value = change.value
            if (
                token.kind is TokenKind.CHANGE_VECTOR
                and isinstance(value, int)
                and size < 32
                and value >> size - 1
            ):
                value -= 1 << size
            paths[path].append((time, value))
    assert not scopes
    return paths, time


def values_by_step(changes, start, steps):
    """Return a signal step by step, from its changes."""
    found, at = [], dict(changes)
    value = None
    for time in range(start + steps):
        value = at.get(time, value)
        found.append(value)
    return [int(value) for value in found[start:]]
