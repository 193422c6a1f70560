"""The figures of report.json as frozen types, one module per subject, with their writer and their reader."""
