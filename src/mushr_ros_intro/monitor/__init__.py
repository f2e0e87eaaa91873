"""Watch the drives of any node, and report how each of them ended."""
