"""The HTML report: sentences, tables and figures of one study on one page that opens offline and prints."""
