"""What the site makes of the package itself: reference pages, formulas, checks."""
