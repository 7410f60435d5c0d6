/PROG  WELD1
/ATTR
OWNER		= MNEDITOR;
COMMENT		= "J1 = 5.000 deg";
DEFAULT_GROUP	= 1,*,*,*,*;
/APPL
/MN
   1:  !P[1] home, 10.000 deg ;
   2:  UFRAME_NUM=0 ;
   3:J P[1] 100% FINE    ;
   4:L P[2] 500mm/sec CNT50    ;
   5:L P[3:above part] 200mm/sec FINE INC    ;
   6:L P[4] 200mm/sec FINE Offset,PR[3]    ;
   7:J PR[5] 20% FINE    ;
   8:L P[5] 100mm/sec FINE    ;
   9:J P[6] 100% FINE    ;
/POS
P[1]{
   GP1:
	UF : 0, UT : 0,	
	J1=     0.000 deg,	J2=    10.000 deg,	J3=   -20.000 deg,
	J4=     0.000 deg,	J5=   -70.000 deg,	J6=     0.000 deg
};
P[2]{
   GP1:
	UF : 0, UT : 0,		CONFIG : 'N U T, 0, 0, 0',
	X =  1904.939  mm,	Y =   662.417  mm,	Z =   -93.227  mm,
	W =   179.729 deg,	P =   -20.350 deg,	R =  -146.687 deg
};
P[3:"above part"]{
   GP1:
	UF : 0, UT : 0,		CONFIG : 'N U T, 0, 0, 0',
	X =     0.000  mm,	Y =     0.000  mm,	Z =   100.000  mm,
	W =     0.000 deg,	P =     0.000 deg,	R =     0.000 deg
};
P[4]{
   GP1:
	UF : 0, UT : 0,		CONFIG : 'F U T, 0, 0, 0',
	X =  2104.690  mm,	Y =  -495.788  mm,	Z =  1015.397  mm,
	W =   173.745 deg,	P =     9.189 deg,	R =  -166.813 deg
};
P[5]{
   GP1:
	UF : 3, UT : 2,		CONFIG : 'N U T, 0, 0, 0',
	X =   100.000  mm,	Y =   200.000  mm,	Z =    50.000  mm,
	W =   180.000 deg,	P =     0.000 deg,	R =     0.000 deg
};
P[6]{
   GP1:
	UF : 0, UT : 0,	
	J1=   -15.000 deg,	J2=     5.000 deg,	J3=    -5.000 deg,
	J4=   -10.000 deg,	J5=   -80.000 deg,	J6=    30.000 deg
   GP2:
	UF : 0, UT : 0,	
	J1=     6.425 deg
};
/END
