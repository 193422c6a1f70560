"""Examples that hypothesis makes: the same in every run, unless a profile is asked for.

A run is then good or bad for what changed, not by luck. To look for new examples: ``make soak``.
"""

from hypothesis import HealthCheck, settings

settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("soak", deadline=None, suppress_health_check=list(HealthCheck))
if settings.get_current_profile_name() == "default":
    settings.load_profile("same")
