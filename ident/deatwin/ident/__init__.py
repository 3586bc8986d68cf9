"""Identification: recordings -> models -> frequency responses; recordings against a plant -> diagnosis."""
