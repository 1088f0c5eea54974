"""What solves for the page: tabs with their scenes and results, and a process for every task."""
