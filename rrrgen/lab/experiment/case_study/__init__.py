"""The case study of the RRR arm (Kostic, de Jager, Steinbuch 2005, section 14.6) on the virtual robot."""
