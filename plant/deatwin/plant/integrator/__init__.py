"""One implicit step of a plant over a sample: collocation, Newton's method, compiled code."""
