"""What every wing may use and that knows no control: checks of arguments, files, CSV, JSON, TOML, text, units."""
