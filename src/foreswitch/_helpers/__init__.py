"""What every wing may use and that knows no control: checks of arguments, files written whole, CSV, text."""
