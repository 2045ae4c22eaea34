"""Interactive charts of the pages, one module per subject; each module makes tables and charts of them."""
