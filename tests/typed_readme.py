import calibrary

camera = calibrary.extract("survey").cameras[0]
change = calibrary.compare(calibrary.read("survey/DJI_0001.JPG"), calibrary.read("survey/DJI_0002.JPG"))
answer = calibrary.open_registry("fleet").resolve("survey/DJI_0001.JPG")
if camera.calibration and answer.calibration:  # without evidence there is None, never a guess
    K, dist = camera.calibration.to_opencv()
    print(camera.verdict, K[0, 2], change.verdict, answer.status, answer.calibration.intrinsics.fx)
# valid 2731.25 identical approved 3659.5
