"""The open core, the hardware of this project: its SystemVerilog, and programs played on it."""
