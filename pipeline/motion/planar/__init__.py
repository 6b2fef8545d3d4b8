"""The motions of the paper: polynomials in x and y, drawn by level (section 2.3 and appendix
D.3)."""
