"""Looking at what ran: finding runs and their records, running them again, gathering reports."""
