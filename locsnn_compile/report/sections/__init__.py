"""The sections of the report: each turns figures into headings, sentences and tables, without any form."""
