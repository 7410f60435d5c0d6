/PROG  SEAM
/ATTR
COMMENT		= "two joint targets, two poses";
DEFAULT_GROUP	= 1,*,*,*,*;
/MN
   1:  UFRAME_NUM=0 ;
   2:  UTOOL_NUM=0 ;
   3:J P[1:home] 50% FINE    ;
   4:L P[2] 200mm/sec FINE    ;
   5:L P[3] 200mm/sec CNT20    ;
   6:J P[4] 20% FINE    ;
   7:J P[1:home] 50% FINE    ;
/POS
P[1:"home"]{
   GP1:
	UF : 0, UT : 0,	
	J1=     0.000 deg,	J2=    10.000 deg,	J3=   -20.000 deg,
	J4=     0.000 deg,	J5=   -70.000 deg,	J6=     0.000 deg
};
P[2]{
   GP1:
	UF : 0, UT : 0,		CONFIG : 'N U T, 0, 0, 0',
	X =  2330.200  mm,	Y =  -300.000  mm,	Z =   420.530  mm,
	W =   180.000 deg,	P =     0.000 deg,	R =   180.000 deg
};
P[3]{
   GP1:
	UF : 0, UT : 0,		CONFIG : 'N U T, 0, 0, 0',
	X =  2330.200  mm,	Y =   300.000  mm,	Z =   420.530  mm,
	W =   180.000 deg,	P =     0.000 deg,	R =   180.000 deg
};
P[4]{
   GP1:
	UF : 0, UT : 0,	
	J1=    15.000 deg,	J2=     5.000 deg,	J3=   -15.000 deg,
	J4=    10.000 deg,	J5=   -60.000 deg,	J6=   -20.000 deg
};
/END
