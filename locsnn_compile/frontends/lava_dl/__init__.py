"""Read lava-dl ``.net`` files."""
