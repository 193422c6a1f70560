"""Play an emitted ``xylo/run.py`` in rockpool without samna: ``without_samna.py SCRIPT``.

Only a device needs samna, and its package on the index is a stub that fetches it from elsewhere when it is imported. Here
modules of its name are empty: every name that rockpool imports from them is a class, whose attributes are empty classes too.
"""

import runpy
import sys
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec


class EmptyModules(MetaPathFinder, Loader):
    """Finds samna and all modules below it."""

    def find_spec(self, fullname, path=None, target=None):
        """Return a module without a file."""
        del path, target
        return ModuleSpec(fullname, self, is_package=True) if is_samna(fullname) else None

    def exec_module(self, module):
        """Give every name a class."""
        module.__getattr__ = empty_class


def is_samna(name):
    """Return whether a module is samna or one of its submodules."""
    return name.split(".")[0] == "samna"


class EmptyClass(type):
    """Makes classes that have a class of every name."""

    def __getattr__(cls, name):
        return empty_class(name)


def empty_class(name):
    """Return an empty class of this name; names with two underscores raise AttributeError, or imports would misread them."""
    if name.startswith("__"):
        raise AttributeError(name)
    return EmptyClass(name, (), {})


if __name__ == "__main__":
    sys.meta_path.insert(0, EmptyModules())
    runpy.run_path(sys.argv[1], run_name="__main__")
