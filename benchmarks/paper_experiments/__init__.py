"""The four papers' claims, one module for each, and what they share."""
