"""The options of all commands: a module for each, and one for what several share."""
