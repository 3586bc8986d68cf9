"""Find a free form, a force without physical meaning, if no effect of the catalogue explains a mismatch."""
