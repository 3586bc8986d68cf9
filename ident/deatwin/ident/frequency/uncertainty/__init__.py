"""From the covariance of parameters to regions of frequency responses: by derivatives, and by draws beside them."""
