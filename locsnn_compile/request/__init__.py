"""What is asked of the compiler, and the setting that it chooses where it is left to choose."""
