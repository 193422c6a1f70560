from .reading import load as load
