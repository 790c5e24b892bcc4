"""What a plug-in of each kind must keep to, as checks that its author can run: `ltvn plugins test NAME`."""
