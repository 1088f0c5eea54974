"""The viewer, a local web page: `form` is what it asks, `solving` works it out, `page` shows it, `server`
answers and guards the door."""
