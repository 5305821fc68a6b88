"""Published models fitted, cross-validated and compared."""
