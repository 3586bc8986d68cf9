"""A plant without some documented physics: diagnosed, then judged on recordings that were held out."""
