"""The report of a study: plots, and the page that holds them."""
