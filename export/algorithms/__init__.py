"""Networks, and the algorithms that train them."""
