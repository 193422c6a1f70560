"""Weights onto the chip's grid: each by itself, or together so that errors cancel."""
