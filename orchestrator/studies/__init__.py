"""Studies of and with runs: audits, conditioning of bases, stopping by precision, seismograms. Not used by the core."""

__all__ = ["audit", "conditioning", "precision", "seismograms"]
