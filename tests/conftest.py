"""How hypothesis looks for examples in all tests."""

from hypothesis import HealthCheck, settings

# An example may take long where other tests have the processors: time says nothing about a law.
settings.register_profile("shared machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("shared machine")
