// loops: what a software rasteriser skips.
// Mesa's llvmpipe runs both sides of a branch, and a loop's body until no lane wants another round,
// but looks at that only at the body's end. So expensive stages are written as
//     int k = wanted ? 0 : LAST;
//     do { ... } while (++k <= LAST);
// which costs one round where nothing is wanted. On a GPU it is a loop like any other.
