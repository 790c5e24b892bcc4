"""The HTTP and websocket server with its access checks, and the content that it serves to the browser."""
