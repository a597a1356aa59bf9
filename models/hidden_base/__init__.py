"""The hidden base: what a scan saw of the gap, and draws of the base that it did not see."""

__all__ = [
    "draw_bases", "gap", "inspection", "intervals", "near_interface", "observed", "rough_base", "standing",
    "unseen_base",
]  # fmt: skip
