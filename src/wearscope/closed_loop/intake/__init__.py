"""From a folder to signals: format, cleaning, filters, and what the channels may really be."""
