"""Pictures: every function takes a result and returns the axes it drew on."""
