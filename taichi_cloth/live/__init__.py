"""A scene in the browser as it runs: its parameters are turned, its cloth is pulled."""
