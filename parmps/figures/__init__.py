"""Pictures, tables and pages of results; the only part that needs matplotlib."""
