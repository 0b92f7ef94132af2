// loops: the form of expensive loops, which a software rasteriser can leave early. Comments only.
// Mesa's llvmpipe runs both sides of a branch. It runs a loop's body until no lane continues, and
// tests that only at the end of the body. Expensive stages are therefore written as
//     int k = wanted ? 0 : LAST;
//     do { ... } while (++k <= LAST);
// which costs one iteration where nothing is to be done. On a GPU this is an ordinary loop.
