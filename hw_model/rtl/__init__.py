"""The open hardware core: its SystemVerilog, what it is loaded with, and programs played on it."""
