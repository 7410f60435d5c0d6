from calibtool.cli import main

main()
