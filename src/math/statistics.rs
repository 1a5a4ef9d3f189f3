//! Running moments and the tests of hypotheses that comparisons of images rest on.
