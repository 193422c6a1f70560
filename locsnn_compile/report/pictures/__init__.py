"""Drawings of the page, as inline SVG: one function a picture, one picture a file.

Lengths across are percentages, so a drawing is as wide as its place; lengths down are pixels. No drawing needs colour
to be understood: parts differ in pattern, dash, place or shape, and each drawing says itself in words.
"""
