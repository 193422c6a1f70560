"""Write files and folders whole or not at all, read untrusted files with care, and check arguments and records."""
