// Tables that sort and filter.
