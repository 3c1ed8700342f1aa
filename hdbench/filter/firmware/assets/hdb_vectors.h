/* Samples, and what the filter of the host answers in double precision. */
#ifndef HDB_VECTORS_H
#define HDB_VECTORS_H

#define HDB_VECTORS @SAMPLES@
#define HDB_TOLERANCE (@TOLERANCE@) /* N m */
#define HDB_TOLERANCE_UNRESOLVED (@UNRESOLVED@)

@ARRAYS@
#endif
