"""Does an explanation hold on data that no fit has seen, against shams and in every part?"""
