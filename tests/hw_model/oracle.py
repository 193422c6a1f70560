"""An independent re-implementation of the chip's step: dense, global, in Python integers; shares no code with hw_model."""

from __future__ import annotations

import numpy as np


def decay(x: int, d: int) -> int:
    left = (abs(x) * (4096 - d)) // 4096
    return left if x >= 0 else -left


def wrap(x: int, bits: int) -> int:
    while x >= 2**bits:
        x -= 2 ** (bits + 1)
    while x < -(2**bits):
        x += 2 ** (bits + 1)
    return x


def run(
    groups: list[dict], links: list[dict], events: dict[str, np.ndarray], steps: int
) -> dict[str, dict[str, np.ndarray]]:
    """Simulate groups in order (joined children must come before parents) and return arrays by probe and group."""
    out = {
        probe: {g["name"]: np.zeros((steps, g["size"]), dtype=np.int64) for g in groups}
        for probe in ("spikes", "u", "v")
    }
    state = {g["name"]: {key: [0] * g["size"] for key in ("u", "v", "hold")} for g in groups}
    sent = {g["name"]: [] for g in groups} | {
        name: [list(row) for row in rows] for name, rows in events.items()
    }
    totals = {"charge_wraps": 0, "current_wraps": 0, "voltage_clips": 0}
    for t in range(steps):
        passed = {g["name"]: [0] * g["size"] for g in groups}
        fired_now = {}
        for g in groups:
            s, fired = state[g["name"]], []
            for i in range(g["size"]):
                total = 0
                for link in links:
                    if link["target"] != g["name"]:
                        continue
                    for j in range(link["weights"].shape[1]):
                        when = t - 1 - int(link["delay"][i, j])
                        if (
                            when >= 0
                            and when < len(sent[link["source"]])
                            and sent[link["source"]][when][j]
                        ):
                            exponent = link["exponent"]
                            m = int(link["weights"][i, j])
                            total += 64 * (m * 2**exponent if exponent >= 0 else m // 2**-exponent)
                q = wrap(total, 21)
                totals["charge_wraps"] += q != total
                u = decay(s["u"][i], g["decay_u"][i]) + q
                s["u"][i] = wrap(u, 23)
                totals["current_wraps"] += s["u"][i] != u
                spike = False
                if s["hold"][i] > 0:
                    s["hold"][i] -= 1
                    s["v"][i] = 0
                else:
                    drive = wrap(s["u"][i] + g["bias"][i], 23)
                    totals["current_wraps"] += drive != s["u"][i] + g["bias"][i]
                    v = decay(s["v"][i], g["decay_v"][i]) + drive + passed[g["name"]][i]
                    kept = max(g["vmin"], min(g["vmax"], v))
                    totals["voltage_clips"] += kept != v
                    spike = g["joined_to"] is None and kept > 64 * g["threshold"][i]
                    s["v"][i] = 0 if spike else kept
                    if spike:
                        s["hold"][i] = g["refractory"][i] - 1
                if g["joined_to"] is not None:
                    passed[g["joined_to"]][i] += s["v"][i]
                fired.append(int(spike))
                out["spikes"][g["name"]][t, i] = spike
                out["u"][g["name"]][t, i] = s["u"][i]
                out["v"][g["name"]][t, i] = s["v"][i]
            fired_now[g["name"]] = fired
        for name, fired in fired_now.items():
            sent[name].append(fired)
    out["totals"] = totals
    return out
