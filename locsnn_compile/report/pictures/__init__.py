"""Drawings of the page and pictures in files of their own, as SVG."""
