"""Convert models, plants and frequency responses to objects of python-control, and linear systems back."""
