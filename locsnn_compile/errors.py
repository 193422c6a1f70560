"""The compiler's errors are those of :mod:`hw_model.errors`; one tree for both packages."""

from hw_model.errors import InputError, LocsnnError, TargetError, check_known, check_most, check_range, did_you_mean

__all__ = ["InputError", "LocsnnError", "TargetError", "check_known", "check_most", "check_range", "did_you_mean"]
