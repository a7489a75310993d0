"""What results can do in a Python session or a notebook: tables, figures, HTML, and folders; see `present`."""
