"""The browser view: rosbridge's protocol, and the pages and files of the server."""
