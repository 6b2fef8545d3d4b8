"""Servers of other projects, and the harness of one."""
