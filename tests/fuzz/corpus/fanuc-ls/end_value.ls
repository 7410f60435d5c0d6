/PROG END
/MN
   1:L P[1] 100mm/sec FINE ;
/POS
P[1]{
   GP1:
 UF : 0, UT : 1, CONFIG : 'N U T, 0, 0, 0',
 X = 900.0 mm, Y = 0.0 mm, Z = 900.0 mm, W = 180.0 deg, P = 0.0 deg, R = 0.0 deg, END = 1.0 mm
};
/END
