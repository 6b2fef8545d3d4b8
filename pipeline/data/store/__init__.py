"""Datasets on object stores."""
