"""Identification: recordings -> models -> frequency responses, and recordings against a plant -> diagnosis."""
