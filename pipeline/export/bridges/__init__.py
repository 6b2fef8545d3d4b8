"""Formats of single projects."""
