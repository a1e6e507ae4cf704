/*
@ABOUT@
 */
#include "@N@.h"
@BODY@