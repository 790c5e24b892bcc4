"""What happened when: the run as the page looks at it."""
