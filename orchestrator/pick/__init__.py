"""`toppling scan --pick`: hints for a scan by clicks on its point cloud."""

__all__ = ["server"]
