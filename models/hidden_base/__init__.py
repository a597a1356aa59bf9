"""The hidden base: what a scan saw of the gap, and draws of the base that it did not see."""

__all__ = [
    "draws",
    "from_scan",
    "gap",
    "inspection",
    "intervals",
    "near_interface",
    "observed",
    "rough_base",
    "standing",
]  # fmt: skip
