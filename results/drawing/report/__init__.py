"""Page about a run that a reviewer can read without the program and without a network, and attach to a paper."""

__all__ = ["constraint_page", "content", "gallery_page", "headline", "page"]
