"""Constitutive laws: energies and stresses of films, permittivity, breakdown."""
