"""Compare frequency responses of models or records by order and band."""
