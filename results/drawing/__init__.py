"""Every picture and page: drawing only, from tables and scenes that other modules made."""
