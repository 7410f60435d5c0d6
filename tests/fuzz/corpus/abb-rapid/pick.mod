MODULE Pick
  ! CONST jointtarget old:=[[1,2,3,4,5,6],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PERS tooldata gripper:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,50],[1,0,0,0],0,0,0]];
  TASK PERS wobjdata table:=[FALSE,TRUE,"",[[1000,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
  CONST jointtarget home:=[[0,10,-10,0,-70,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget p10:=[[1904.939,662.417,-93.227],[0.16991,0.281727,-0.943089,0.048407],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget p20:=[[1104.69,-495.788,915.397],[0,0,1,0],[-1,-1,0,1],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];
  CONST robtarget spare:=[[1104.69,-495.788,915.397],[0,0,1,0],[-1,-1,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PROC main()
    MoveAbsJ home\NoEOffs,v1000,z50,tool0;
    MoveJ p10,v500,fine,tool0;             ! first hole
    MoveL Offs(p10,0,0,50),v100,fine,tool0;
    MoveL p20,v100,fine,gripper\WObj:=table;
    MoveL pTaught,v100,fine,tool0;
    MoveAbsJ [[-15,5,0,-10,-80,30],[9E9,9E9,9E9,9E9,9E9,9E9]],v1000,z50,tool0;
    MoveL [[1904.939,662.417,6.773],[0.16991,0.281727,-0.943089,0.048407],[0,0,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine,tool0\WObj:=wobj0;
    MoveL [[0,0,0],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine,tool0\WObj:=vise;
  ENDPROC
ENDMODULE
