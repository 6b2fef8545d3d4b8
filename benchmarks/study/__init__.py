"""Closed-loop evaluation of the reference policies, measured: what is run, the rows, tables and
plots."""
