"""The viewer, a local web page: `form` is what it asks, `solving` works it out, `figures` and `page` show it, `server`
answers and guards the door."""
