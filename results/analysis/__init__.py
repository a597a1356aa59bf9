"""What the rows of runs say: shares, curves and their uncertainty. Nothing here draws."""
