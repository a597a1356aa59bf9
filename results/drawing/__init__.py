"""Every picture and page: drawing only, from tables and scenes that other modules made."""

from toppling.models import matplotlib_alone as matplotlib_alone
