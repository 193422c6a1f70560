"""Read value change dumps (VCD waveform files) with pyvcd, to compare them with registers of the simulator."""

from __future__ import annotations

import io

from vcd.reader import TokenKind, tokenize


def read_vcd(content):
    """Return the changes of each signal as ``{path: [(time, value)]}``, and the last time.

    Vectors of fewer than 32 bits are read as two's complement; pyvcd gives them without a sign.
    """
    paths = {}
    scopes = []
    codes = {}
    time = 0
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
            is_number = token.kind is TokenKind.CHANGE_VECTOR and isinstance(value, int)
            if is_number and size < 32 and value >> size - 1:
                value -= 1 << size
            paths[path].append((time, value))
    assert not scopes
    return paths, time


def values_by_step(changes, start, steps):
    """Return the value of a signal in each step from ``start`` on, from its changes; a step is a unit of time."""
    value_at_time = dict(changes)
    values = []
    value = None
    for time in range(start + steps):
        value = value_at_time.get(time, value)
        values.append(value)
    return [int(value) for value in values[start:]]
