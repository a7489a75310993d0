"""The package's presets, one TOML file each."""
