"""The hidden base: what a scan saw of the gap, and draws of the base that it did not see."""
