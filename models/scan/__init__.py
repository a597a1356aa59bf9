"""Clouds to scenes: read, split, close, measure; and a virtual scanner. The only room that knows Open3D."""
