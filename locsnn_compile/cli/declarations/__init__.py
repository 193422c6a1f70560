"""The options of all commands: a module for each command, and one for what several share.

They lie apart from the commands, so that help and shell completion import nothing heavy.
"""
