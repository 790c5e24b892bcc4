"""The guarded HTTP and websocket server, and what it serves to the browser."""
