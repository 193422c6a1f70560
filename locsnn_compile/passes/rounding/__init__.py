"""Weights onto the chip's grid: apart, or together so that errors cancel."""
