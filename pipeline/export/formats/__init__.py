"""Formats that robot learning at large reads, one module or folder a format."""
