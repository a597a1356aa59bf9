"""MuJoCo: a second engine, for cheap realisations and as an independent check."""

__all__ = ["description"]
