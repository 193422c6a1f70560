"""lava-dl ``.net`` files in."""
