"""Generator of concealed cases: it shares no code and no parameter with the effects of the catalogue."""
