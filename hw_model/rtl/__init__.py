"""The open core, the hardware of this project: its SystemVerilog, programs in its memory words, and
recordings played on it."""
