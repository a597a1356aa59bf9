"""Clouds to scenes: read, split, close, measure; and a virtual scanner. The only room that knows Open3D."""

from toppling.models import matplotlib_alone as matplotlib_alone
