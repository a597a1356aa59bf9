"""What is done with runs: audited, conditioned, ended by precision, repeated, scored. The core never imports it."""

__all__ = ["audit", "conditioning", "precision", "seismograms"]
