"""`toppling scan --pick`: a scan's hints given by clicks on its cloud."""

__all__ = ["pick_servers"]
